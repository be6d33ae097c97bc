"""Memory that a configuration will need, estimated before anything is made."""

MOST_MEMORY = 2.5e9
"""What needs more at once is refused [bytes]: ten million points of a surface do, as those of a
crane of 100 m at a spacing of 9 mm."""
SAMPLE = 250
"""Of a point of a surface while shapes are sampled, as measured [bytes]."""
MESH_SAMPLE = 850
"""Of a point of a mesh, which is sampled more densely and thinned, as measured [bytes]."""
TAXEL = 100
"""Of a taxel: its place and its statistics [bytes]."""
HYPOTHESIS = 350
"""Of a hypothesis on its way from a generator to the hypothesis space, as measured [bytes]."""


def too_much(what: str, count: float, each: int, of: str = "points") -> str:
    """The sentence on what needs too much memory; empty where it does not.

    Args:
        what: what is to be made, with its size.
        count: how many of them.
        each: the memory of each [bytes].
        of: the plural of what is counted.
    """
    if count * each <= MOST_MEMORY:
        return ""
    return (
        f"{what} is {counted(count)} {of}, {size(count * each)}, more than {MOST_MEMORY / 1e9:g} GB"
    )


def counted(count: float) -> str:
    """A number as text, of a million and more to three digits."""
    if count < 1e6:
        return f"{count:.0f}"
    return f"{count / 1e6:.3g} million" if count < 1e9 else f"{count / 1e9:.3g} billion"


def size(memory: float) -> str:
    """An amount of memory [bytes] as text, to two digits."""
    units = (("GB", 1e9), ("MB", 1e6), ("kB", 1e3))
    name, unit = next((one for one in units if memory >= one[1]), units[-1])
    return f"about {float(f'{memory / unit:.2g}'):g} {name}"
