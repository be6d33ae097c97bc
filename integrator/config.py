"""The configuration of the integrator."""

import warnings
from collections.abc import Mapping
from typing import Any, Literal

import yaml
from pydantic import (
    Field,
    SerializerFunctionWrapHandler,
    model_serializer,
    model_validator,
)

from contactfusion.errors import AGAINST, REMOVED, ConfigurationError
from contactfusion.model import Model
from contactfusion.units import Memory, Spacing, Tolerance

THRESHOLD, THRESHOLDS = 0.1, {"members": 0.5}
"""The threshold by default, and with some condensations."""
PARTS = {"rule": "rule_options", "condensation": "condensation_options"}
"""The fields that name a plug-in, and those that hold its options."""
FORMER = {"rule": "de_morgan", "condensation": "cluster_centroid"}
"""The defaults of 0.1.0."""
MOVED = {
    "floor": ("rule", ("sets", "posterior")),
    "friction": ("rule", ("sets", "posterior")),
    "existence": ("condensation", ("members", "modes")),
    "mode_share": ("condensation", ("modes",)),
    "min_voxels": ("condensation", ("cluster_centroid",)),
    "mass_threshold": ("condensation", ("cluster_mass",)),
}
"""Fields up to 0.1.0 that are options of a rule or condensation now: of which part, by which names.
"""


class IntegratorConfig(Model):
    """How hypotheses are kept, fused and condensed (method §1-3).

    `rule` and `condensation` are names, or mappings of `type` and options, such as
    ``{type: sets, floor: 0.02}``. Where only one of both is given, the other goes with it: `sets`
    with `members`, another rule with `cluster_centroid`, another condensation with `de_morgan`.
    """

    frame: str = Field(default="base", min_length=1)
    """The frame in which the voxels stand still; every cloud must come in it."""
    voxel_size: Spacing = Field(default=0.005, ge=1e-5)
    """The side of a voxel [m]."""
    timeout: Memory = Field(default=0.5, gt=0)
    """How long an entry lives [s], where its source has no timeout of its own."""
    expiry: Literal["source", "voxel"] = "source"
    """`source`: an entry lives by its own stamp; `voxel`: all entries of a voxel live by the newest
    (F §III-B)."""
    rule: str = "sets"
    """How hypotheses are fused."""
    rule_options: dict[str, Any] = Field(default_factory=dict)
    """The options of the rule, fields of its `Config`."""
    condensation: str = "members"
    """How what is fused becomes contacts."""
    condensation_options: dict[str, Any] = Field(default_factory=dict)
    """The options of the condensation, fields of its `Config`."""
    threshold: float = Field(default=THRESHOLDS["members"], gt=0, le=1)
    """The fused likelihood from which a voxel, or a contact of a set, is a contact; 0.1 with other
    condensations than `members`."""
    tolerance: Tolerance | None = Field(default=None, gt=0)
    """Voxels at most this far apart belong to one contact [m]; None: two sides of a voxel."""
    stale_after: Memory = Field(default=1.0, gt=0)
    """A source silent for longer no longer holds up readiness [s]."""
    max_ahead: Memory = Field(default=0.1, ge=0)
    """A stamp further ahead of now is held back until its time [s]."""
    max_hypotheses: int = Field(default=2_000_000, ge=1)
    """A cloud of more hypotheses is refused."""
    strict_sources: bool = False
    """Whether a cloud of a source that was never plugged is an error."""

    @property
    def condensed_by(self) -> dict[str, Any]:
        """The options of the condensation, with the threshold where it is one of them."""
        if self.condensation != "members":
            return self.condensation_options
        return {**self.condensation_options, "existence": self.threshold}

    def using(self, rule: str, condensation: str) -> "IntegratorConfig":
        """With another rule and condensation, without the options of those before.

        The threshold stays as it is if it was not the default one.
        """
        same = {"rule": rule == self.rule, "condensation": condensation == self.condensation}
        left_out = {part for part, is_same in same.items() if not is_same}
        if self.threshold == THRESHOLDS.get(self.condensation, THRESHOLD):
            left_out.add("threshold")
        fields = self.model_dump(exclude=left_out)
        return IntegratorConfig(**{"rule": rule, "condensation": condensation, **fields})

    @property
    def linking_distance(self) -> float:
        """Voxels at most this far apart belong to one contact [m]."""
        return 2.0 * self.voxel_size if self.tolerance is None else self.tolerance

    @model_validator(mode="before")
    @classmethod
    def _part_by_part(cls, value: Any) -> Any:
        """Part names from options, and read fields of 0.1.0."""
        if not isinstance(value, Mapping):
            return value
        fields = dict(value)
        if fields.pop("options", None):
            raise ConfigurationError(
                "options of a plug-in stand beside its name now, as in "
                "`rule: {type: NAME, option: value}`",
                "options",
            )
        for part, held in PARTS.items():
            if isinstance(given := fields.get(part), Mapping):
                options = {key: given[key] for key in given if key != "type"}
                fields[part] = given.get("type", cls.model_fields[part].default)
                fields[held] = {**options, **fields.get(held, {})}
        return _with_threshold(_paired(_moved(fields)))

    @model_serializer(mode="wrap")
    def _with_options(self, serialize: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Names and options as a file holds them, so that a new name replaces both."""
        fields: dict[str, Any] = serialize(self)
        for part, held in PARTS.items():
            if options := fields.pop(held, None):
                fields[part] = {"type": getattr(self, part), **options}
        return fields


def _paired(fields: dict[str, Any]) -> dict[str, Any]:
    """The fields, where a rule is given with its condensation, and the other way round."""
    if "rule" not in fields and fields.get("condensation", "members") != "members":
        return {**fields, "rule": "de_morgan"}
    if "condensation" not in fields and fields.get("rule", "sets") != "sets":
        return {**fields, "condensation": "cluster_centroid"}
    return fields


def _with_threshold(fields: dict[str, Any]) -> dict[str, Any]:
    """The fields with the threshold of the condensation; of a set it is that of existence."""
    if fields.get("condensation", "members") != "members":
        return {"threshold": THRESHOLD, **fields}
    held = dict(fields.get("condensation_options", {}))
    if "existence" not in held:
        return fields
    existence = held.pop("existence")
    if fields.get("threshold", existence) != existence:
        problem = f"is the same as the threshold, which is {fields['threshold']}: leave one out"
        raise ConfigurationError(problem, "condensation.existence")
    return {**fields, "threshold": existence, "condensation_options": held}


def _moved(fields: dict[str, Any]) -> dict[str, Any]:
    """The fields with those of 0.1.0 as options of their rule or condensation.

    Warns:
        FutureWarning: names the new place of each; of `prior`, what takes its place.
    """
    if "prior" in fields:
        del fields["prior"]
        if str(fields.get("rule")) not in REMOVED["rule"]:  # else the error on the rule says it
            problem = f"was removed with its rules: leave it out, or {AGAINST}"
            warnings.warn(f"`prior` of the integrator {problem}", FutureWarning, stacklevel=2)
    for key in [key for key in fields if key in MOVED]:
        value = fields.pop(key)
        part, owners = MOVED[key]
        if FORMER[part] in owners:
            fields.setdefault(part, FORMER[part])
        name, held = fields.get(part, IntegratorConfig.model_fields[part].default), PARTS[part]
        owner = name if name in owners else owners[0]
        is_removed = owner in REMOVED[part]
        options = {"type": owner, key: value}
        text = yaml.safe_dump(options, default_flow_style=True, sort_keys=False).strip()
        place = f"`{part}: {text}`"
        if name in owners:
            fields[held] = {**fields.get(held, {}), key: value}
            if is_removed:  # the error on it says what to do
                continue
            problem = f"is an option of the {part} now: write {place}"
        elif is_removed:
            problem = f"has no effect with the {part} '{name}': leave it out"
        else:
            problem = f"has no effect with the {part} '{name}'; it is an option of {place}"
        warnings.warn(f"`{key}` of the integrator {problem}", FutureWarning, stacklevel=2)
    return fields
