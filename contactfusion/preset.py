"""Presets of a configuration: named options in place of defaults."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from contactfusion.errors import ConfigurationError, name_hint

Options = Mapping[str, Any]


@dataclass(frozen=True)
class Preset:
    """Options of plug-ins and of the integrator.

    Attributes:
        generators: options by the type of the generator.
        integrator: options.
        controllers: options by the type of the controller.
    """

    generators: Mapping[str, Options]
    integrator: Options
    controllers: Mapping[str, Options]

    def beneath(self, fields: Options) -> dict[str, Any]:
        """The fields of a configuration, which keep what they give."""
        return self._joined(fields, lambda preset, given: {**preset, **given})

    def over(self, fields: Options) -> dict[str, Any]:
        """The fields of a configuration, in which the preset replaces what they give."""
        return self._joined(fields, lambda preset, given: {**given, **preset})

    def _joined(self, fields: Options, join: Any) -> dict[str, Any]:
        def of_type(presets: Mapping[str, Options], options: Any) -> Any:
            kind = str(options.get("type")) if isinstance(options, Mapping) else ""
            return join(presets[kind], options) if kind in presets else options

        joined = dict(fields)
        if isinstance(given := fields.get("generators"), Mapping):
            joined["generators"] = {
                name: of_type(self.generators, options) for name, options in given.items()
            }
        if isinstance(given := fields.get("integrator", {}), Mapping):
            joined["integrator"] = join(self.integrator, given)
        if "controller" in fields:
            joined["controller"] = of_type(self.controllers, fields["controller"])
        return joined


PRESETS: Mapping[str, Preset] = {
    "paper": Preset(
        generators={
            "tactile": {"p_max": 1.0, "relative_to": "reading"},
            "force_torque": {"friction": None, "unknown_bias": 0.0},
            "range": {"evidence": "motion", "scale": 0.01},
            "lidar_cpm": {"p_max": 1.0, "weights": "paper"},
            "lidar_rule": {"p_max": 1.0},
            "rgbd_cpm": {
                "p_max": 1.0,
                "weights": "paper",
                "ends": "edge",
                "margin": 0.0,
                "body": None,
            },
        },
        integrator={
            "rule": "de_morgan",
            "condensation": "cluster_centroid",
            "threshold": 0.1,
            "tolerance": None,
            "expiry": "voxel",
        },
        controllers={"reactive_pushing": {"parameters": "paper"}},
    )
}
"""`paper`: what both papers print. Likelihoods up to 1 (F Eq 3-5), no friction cone (F Eq 6-7), the
motion gate of range (F §V-D), networks of its training (O §III-B), edges without correction
(O Eq 13-16), De Morgan with one time of expiry a voxel (F §III-B), the parameters of reactive
pushing that their authors used."""


def preset_named(name: str) -> Preset:
    """The preset of a name.

    Raises:
        ConfigurationError: there is none.
    """
    if name not in PRESETS:
        raise ConfigurationError(
            f"unknown preset '{name}'; {name_hint(name, PRESETS, 'presets')}", "preset"
        )
    return PRESETS[name]
