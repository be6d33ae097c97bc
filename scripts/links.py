"""Checks that the relative links of Markdown pages lead to files, and to headings in them.

usage: links.py PAGE ...
"""

import re
import sys
from collections.abc import Iterator
from pathlib import Path

LINK = re.compile(r"\]\(([^()#\s]*)(?:#([^()\s]*))?\)")
"""The target of a link or a picture, and the heading in it."""
CODE = re.compile(r"^```.*?^```", re.MULTILINE | re.DOTALL)


def links(page: Path) -> Iterator[tuple[Path, str]]:
    """The file and the heading, if any, of each relative link of a page, also by pictures."""
    for target, heading in LINK.findall(CODE.sub("", page.read_text())):
        if "://" not in target:
            yield (page.parent / target if target else page).resolve(), heading


def headings(page: Path) -> set[str]:
    """The headings of a page as links name them."""
    titles = re.findall(r"^#+ (.*)$", CODE.sub("", page.read_text()), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


def faults(page: Path) -> list[str]:
    """What links of a page do not lead to: a sentence for each."""
    found = list[str]()
    for target, heading in links(page):
        if not target.exists():
            found.append(f"{page}: there is no {target}")
        elif heading and heading not in headings(target):
            found.append(f"{page}: {target} has no heading '#{heading}'")
    return found


if __name__ == "__main__":
    told = [fault for page in sys.argv[1:] for fault in faults(Path(page))]
    sys.exit("\n".join(told) or None)
