"""The page of the demo: one file of HTML, beside the files that it links to."""

import math
from collections.abc import Sequence
from html import escape
from importlib.resources import files
from string import Template

from contactfusion.explain.text import explain_fusion
from contactfusion.hypotheses import HypothesisKind
from contactfusion_lab.demo.account import NAMES, Story, sentences
from contactfusion_lab.demo.scene import Moment

TITLE = "The skin dies, the robot pushes on"
FAILED = "The skin dies, and the robot does not arrive"
KINDS = {
    HypothesisKind.REGULAR: "evidence",
    HypothesisKind.SUPPORT: "support",
}
FILES = {
    "contacts.csv": "every contact: position, likelihood, dispersion, shares",
    "commands.csv": "every command, with the controller's mode and reason",
    "summary.json": "the result",
    "scene.yaml": "the scene, to run again and to change",
    "demo.mcap": "readings, contacts and commands, for ROS 2 tools such as Foxglove or rosbag2",
}


def page(story: Story, written: Sequence[str], size: tuple[int, int]) -> str:
    """The page, as HTML.

    Args:
        story: of the push.
        written: the names of the files beside the page.
        size: of the film [pixels].
    """
    template = files("contactfusion_lab.demo").joinpath("page.html").read_text(encoding="utf-8")
    config = story.fields["integrator"]
    before, after = story.at(story.dies / 2.0), story.at(story.dies * 1.5)
    end = story.last
    values = {
        "title": TITLE if story.arrived else FAILED,
        "lead": escape(_lead(story)),
        "account": escape(" ".join(sentences(story))),
        "when": f"the skin falls silent at {story.dies:.1f} s",
        "rows": _rows(story),
        "film_width": str(size[0]),
        "film_height": str(size[1]),
        "figure_width": "896",
        "figure_height": "576",
        "film_alt": escape(
            f"A film from above: the base pushes a box in an arc to a target behind it. At "
            f"{story.dies:.1f} s its skin falls silent; it pushes on, and after {end.stamp:.1f} s "
            f"it ends: {end.ending}."
        ),
        "distance_alt": "The distance to the target over time, in truth and as believed: it grows "
        "while the robot turns, then falls to the target; with the skin alone it stays where it "
        "was when the skin died.",
        "lateral_alt": "The position of the contact along the robot's front over time: the truth, "
        "fused, and by skin and LiDAR alone; the skin's dots end where it dies.",
        "shares_alt": "The share of each source in the contact over time: the skin's falls to "
        "nothing when it dies, LiDAR and motion take all.",
        "timeout": f"{config['timeout']:g}",
        "voxel": f"{config['voxel_size'] * 100.0:g}",
        "threshold": f"{end.fusion.threshold:g}",
        "before_stamp": f"{before.stamp:.1f}",
        "before": escape(explain_fusion(before.fusion)),
        "before_gloss": escape(_gloss(before)),
        "after_stamp": f"{after.stamp:.1f}",
        "after": escape(explain_fusion(after.fusion)),
        "after_gloss": escape(_gloss(after)),
        "files": "\n".join(
            f'<li><a href="{name}">{name}</a>: {escape(FILES[name])}</li>'
            for name in written
            if name in FILES
        ),
    }
    return Template(template).substitute(values)


def _lead(story: Story) -> str:
    x, y = story.push.target
    sides = f"{abs(x):g} m behind and {abs(y):g} m to the {'left' if y > 0 else 'right'} of"
    goes = "goes on without it, and arrives" if story.arrived else "does not arrive"
    return (
        f"A mobile base pushes a box that it knows nothing of to a place {sides} where they first "
        "touch. It feels the box with a tactile skin and sees it with a LiDAR; contactfusion makes "
        f"one contact of both. Half-way the skin dies. The base {goes}."
    )


def _rows(story: Story) -> str:
    report = story.last.fusion.report.sources
    rows = []
    for name in story.sources:
        label = f"share of {name} ({KINDS.get(report[name].kind, '')})"
        rows.append((label, *(f"{story.share(name, when):.0%}" for when in (True, False))))
    errors = (_centimetres(story.error(when)) for when in (True, False))
    rows.append(("error of the contact's position along the front", *errors))
    return "\n".join(
        f"<tr><td>{escape(label)}</td><td>{first}</td><td>{second}</td></tr>"
        for label, first, second in rows
    )


def _gloss(moment: Moment) -> str:
    """An explanation of a contact, in words."""
    if moment.contact is None:
        return "There was no contact to explain."
    x, y = moment.contact.position[:2]
    side = "left" if y > 0 else "right"
    sources = [name for name, share in moment.shares.items() if share > 0.0]
    needed = [
        NAMES.get(source, source)
        for source in sources
        if not moment.fusion.without(source).contacts
    ]
    position = (
        f"The contact lies {x:.2f} m ahead of the robot's origin, that is on its front, "
        f"{abs(y) * 100.0:.0f} cm to the {side} of its middle."
    )
    if needed:
        return f"{position} It stands on {' and '.join(needed)}: without that nothing would remain."
    return f"{position} No source is needed for it: whichever fails, the others still know of it."


def _centimetres(metres: float) -> str:
    return "–" if math.isnan(metres) else f"{metres * 100.0:.1f} cm"
