"""Numbers in sentences."""


def counted(count: int, thing: str) -> str:
    """ "1 frame", "2 frames"."""
    return f"{count} {thing}" if count == 1 else f"{count} {thing}s"


def plain(value: float, digits: int = 2) -> str:
    """So many digits that count, never as a power of ten if it is 1e-4 or more: "130", "0.052"."""
    return f"{float(f'{value:.{digits}g}'):.15g}"
