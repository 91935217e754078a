"""Measurements, one per file, found by looking in this folder: `jello study NAME`.

A study has `measure(chosen) -> dict`, the figures, for the options of the call, and `text(told) -> str`, the page that
is printed; `chosen.load()` makes the scene of the call, or with `MANY` it takes all of `chosen.scenes`. It may have
`plot(told, path)` for --plot, with `PLOTS` the suffixes it can write if these are not matplotlib's, and `rows(told)`, a
list of flat dictionaries, for --csv. A `measure` that takes minutes goes through its work by `_report.take`: what it
has so far is kept in the file of --json, and returned at Ctrl-C or SIGTERM with the key `interrupted`.
"""
