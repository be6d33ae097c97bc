"""One line of the doctor's report."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Finding:
    """What was found of one thing.

    Attributes:
        text: a line for people.
        mend: the one command that mends it; empty: there is nothing to mend.
        core: whether contactfusion itself does not work until then.
    """

    text: str
    mend: str = ""
    core: bool = False

    def __str__(self) -> str:
        """Give the line; it ends with the command."""
        return f"{self.text}: {self.mend}" if self.mend else self.text
