"""Estimate of the memory that a configuration needs, before anything is allocated."""

from contactfusion.limits import raised

MOST_MEMORY = 2.5e9
"""The most memory that is allowed at once [bytes]: that of ten million points of a surface, as
those of a crane of 100 m at a spacing of 9 mm."""
SAMPLE = 250
"""Memory of a point of a surface while shapes are sampled, as measured [bytes]."""
MESH_SAMPLE = 850
"""Memory of a point of a mesh, which is sampled more densely and thinned, as measured [bytes]."""
TAXEL = 100
"""Memory of a taxel: its position and its statistics [bytes]."""
HYPOTHESIS = 350
"""Memory of a hypothesis between a generator and the hypothesis space, as measured [bytes]."""


def too_much(what: str, count: float, each: int, of: str = "points") -> str:
    """The sentence on an allocation that needs too much memory; empty where it does not.

    Args:
        what: name and size of what is allocated.
        count: number of elements.
        each: the memory of an element [bytes].
        of: the plural of the elements' name.
    """
    most = raised(MOST_MEMORY)
    if count * each <= most:
        return ""
    return f"{what} is {counted(count)} {of}, {size(count * each)}, more than {most / 1e9:g} GB"


def counted(count: float) -> str:
    """A number as text, from a million on to three digits."""
    if count < 1e6:
        return f"{count:.0f}"
    return f"{count / 1e6:.3g} million" if count < 1e9 else f"{count / 1e9:.3g} billion"


def size(memory: float) -> str:
    """An amount of memory [bytes] as text, to two digits."""
    units = (("GB", 1e9), ("MB", 1e6), ("kB", 1e3))
    name, unit = next((candidate for candidate in units if memory >= candidate[1]), units[-1])
    return f"about {float(f'{memory / unit:.2g}'):g} {name}"
