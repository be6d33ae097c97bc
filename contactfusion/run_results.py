"""What a run gave, as tables."""

import csv
import io
from collections.abc import Sequence

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
