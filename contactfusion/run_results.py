"""What a run gave, as tables and a summary for files, and as lines for people."""

import csv
import io
import math
from collections.abc import Mapping, Sequence
from typing import Any

from contactfusion.contact_rows import COLUMNS, contact_rows
from contactfusion.pipeline import Step


def contacts_csv(steps: Sequence[Step]) -> str:
    """Give one row a contact, as `contact_rows` does, under the names of the columns."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for step in steps:
        writer.writerows(contact_rows(step))
    return text.getvalue()


def commands_csv(steps: Sequence[Step]) -> str:
    """Give one row a command: stamp, twist [m/s, rad/s], gripper, mode, reason."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["stamp", "vx", "vy", "vz", "wx", "wy", "wz", "gripper", "mode", "reason"])
    for step in steps:
        if (command := step.command) is None:
            continue
        twist = command.twist
        numbers = [*twist.linear, *twist.angular] if twist else [""] * 6
        cells = [f"{n:.6g}" if isinstance(n, float) else n for n in (*numbers, command.gripper)]
        writer.writerow([f"{step.stamp:.6f}", *cells, command.mode, command.reason])
    return text.getvalue()


def summary(steps: Sequence[Step]) -> dict[str, Any]:
    """Count steps and contacts, and tell how each source did."""
    last = steps[-1].fusion.report.sources if steps else {}
    return {
        "steps": len(steps),
        "steps_with_contact": sum(bool(step.fusion.contacts) for step in steps),
        "contacts": sum(len(step.fusion.contacts) for step in steps),
        "sources": {
            name: {
                "kind": str(source.kind),
                "rate": None if math.isnan(source.rate) else source.rate,
                "accepted": source.accepted,
                "late": source.late,
                "early": source.early,
                "invalid": source.invalid,
            }
            for name, source in last.items()
        },
        "events": [
            {"stamp": step.stamp, "kind": str(event.kind), "message": event.message}
            for step in steps
            for event in step.events
        ],
    }


def tell(total: Mapping[str, Any], took: float) -> None:
    """Print a summary.

    Args:
        total: as `summary` gives it.
        took: how long the run took [s].
    """
    print(
        f"{total['steps']} steps in {took:.1f} s, {total['steps_with_contact']} with contact, "
        f"{total['contacts']} contacts"
    )
    for name, source in total["sources"].items():
        rate = "no rate" if source["rate"] is None else f"{source['rate']:.4g} Hz"
        print(
            f"  {name} ({source['kind']}): {source['accepted']} clouds, {rate}, "
            f"{source['late']} late, {source['early']} early, {source['invalid']} refused"
        )
    refused = [event for event in total["events"] if event["kind"] == "refused"]
    if refused:
        print(f"  first refusal: {refused[0]['message']}")
