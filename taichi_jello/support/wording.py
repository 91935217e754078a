"""Numbers in sentences."""


def counted(count: int, thing: str) -> str:
    """ "1 frame", "2 frames"."""
    return f"{count} {thing}" if count == 1 else f"{count} {thing}s"


def plain(value: float, digits: int = 2) -> str:
    """Rounded to significant digits, without an exponent from 1e-4 up: "130", "0.052"."""
    return f"{float(f'{value:.{digits}g}'):.15g}"
