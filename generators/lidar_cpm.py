"""Contacts on the face of a base from LiDAR scans, by two LSTM networks (O §II-C, II-D)."""

from collections.abc import Mapping, Sequence

from contactfusion.generator import Generator
from contactfusion.generators.networks import LearnedConfig, LearnedFace
from contactfusion.generators.perceived import points_before
from contactfusion.hooks import hookimpl
from contactfusion.hypotheses import HypothesisCloud
from contactfusion.readings import PointCloud, Reading
from contactfusion.state import State


class LidarCpmGenerator(LearnedFace[LearnedConfig]):
    """Regular, multi contact: the face's contact by the last two seconds of scans."""

    Config = LearnedConfig
    readings = (PointCloud,)

    def generate(self, reading: Reading, state: State) -> Sequence[HypothesisCloud]:
        """The contact on the face.

        Raises:
            FrameError: nothing joins the LiDAR's frame to the robot's.
        """
        assert isinstance(reading, PointCloud)
        points = points_before(reading, state, self.config)
        return self.perceived(reading, state, self.proximity.lengths_of_cloud(points))


@hookimpl
def contactfusion_generators() -> Mapping[str, type[Generator[LearnedConfig]]]:
    """The generator."""
    return {"lidar_cpm": LidarCpmGenerator}
