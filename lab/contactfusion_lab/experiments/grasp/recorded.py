"""One grasp as a recording: what was read, felt and commanded, and what is true, for `explain`."""

from collections.abc import Iterable, Iterator
from pathlib import Path

from contactfusion.recording_scene import EPOCH_NS, TRUTH, fixed_frames
from contactfusion.recordings.mcap import McapWriter
from contactfusion.replaying.configuration import TOPIC, Setting
from contactfusion_lab.experiments.grasp.plan import Column, Grasp, Plan
from contactfusion_lab.scenes.grasp.scene import GraspCycle, GraspScene


def recorded(
    plan: Plan,
    column: Column,
    grasp: Grasp,
    scene: GraspScene,
    cycles: Iterable[GraspCycle],
    path: Path,
) -> Iterator[GraspCycle]:
    """Give the cycles of a grasp, and write them on the way.

    Args:
        plan: the experiment.
        column: by what it is felt.
        grasp: which.
        scene: of the grasp.
        cycles: as they are made.
        path: the MCAP file, which also holds the configuration: `explain` needs no other.

    Raises:
        DependencyError: rosbags is not installed.
        WritingError: the disk does not take it.
    """
    config = plan.pipeline_of(column, grasp.seed)
    fields = config.model_dump(mode="json", exclude_defaults=True, exclude={"folder"})
    # the name of a fault is a default of its model
    if config.faults:
        fields["faults"] = [fault.model_dump(mode="json") for fault in config.faults]
    fields["cycle"] = {"every": scene.config.period}
    with McapWriter(path, EPOCH_NS) as writer:
        writer.text(TOPIC, Setting(fields, config.folder, {}, path).text(beside=path.parent))
        writer.static(fixed_frames(config))
        for cycle in cycles:
            for reading in cycle.readings:
                writer.reading(reading)
            writer.step(cycle.step)
            facts = scene.facts()
            writer.contacts(facts.contacts, facts.frame, facts.stamp, TRUTH)
            for one in facts.objects:
                writer.reading(one, TRUTH)
            yield cycle
