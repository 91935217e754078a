"""Measurements, one study a file: `jello study NAME` finds them in this folder.

A study has `measure(chosen) -> results`, a dictionary that becomes the JSON, and `text(results) -> str`, the page that
is printed. chosen: the options of the call; `chosen.load()` makes its scene, and a study with `MANY` uses all of
`chosen.scenes`. It may have `plot(results, path)` for --plot, with its suffixes in `PLOTS` if they are not those of
matplotlib, and `rows(results)`, a list of flat dictionaries, for --csv. `_report.take` runs a long study in pieces:
after each, the results so far are in the --json file; Ctrl-C and SIGTERM end it with the key `interrupted` set.
"""
