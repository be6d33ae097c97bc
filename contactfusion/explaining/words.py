"""How numbers are put into words."""

from contactfusion.arrays import FloatArray
from contactfusion.explaining.account import Place


def millimetres(metres: float) -> str:
    """Write a distance as one reads it: mm under 10 cm, then cm, then m."""
    if metres < 0.1:
        return f"{metres * 1000.0:.1f} mm"
    return f"{metres * 100.0:.0f} cm" if metres < 1.0 else f"{metres:.1f} m"


def place_words(place: Place | FloatArray) -> str:
    """Write a place [m]."""
    x, y, z = (float(value) for value in place)
    return f"({x:.3f}, {y:.3f}, {z:.3f}) m"


def counted(count: int, singular: str) -> str:
    """Write a number of things."""
    return f"{count} {singular}" if count == 1 else f"{count} {singular}s"
