"""Optional packages: the extras of contactfusion, and its laboratory."""

EXTRAS: dict[str, dict[str, str]] = {
    "plot": {"matplotlib": "matplotlib"},
    "robot": {"pin": "pinocchio", "open3d-cpu": "open3d"},
    "sim": {"pybullet": "pybullet"},
    "learn": {"torch": "torch", "safetensors": "safetensors"},
    "vision": {"opencv-python-headless": "cv2", "open3d-cpu": "open3d"},
    "sam": {"transformers": "transformers"},
    "record": {"rosbags": "rosbags"},
    "parquet": {"pyarrow": "pyarrow"},
    "view": {"rerun-sdk": "rerun"},
    "c3d": {"ezc3d": "ezc3d"},
    "ros2": {"cyclonedds": "cyclonedds", "rosbags": "rosbags"},
}
"""For each extra its packages, with the module of each."""


def installs(extra: str) -> str:
    """The command that installs an extra."""
    return f"pip install 'contactfusion[{extra}]'"


def extra_of(module: str) -> str | None:
    """The extra that installs a module, such as "learn" for "torch.nn"; None: none does."""
    top = module.partition(".")[0]
    return next((extra for extra, packages in EXTRAS.items() if top in packages.values()), None)


def in_lab(what: str) -> str:
    """The sentence that a feature comes with the laboratory, and the command that installs it."""
    return f"{what} comes with contactfusion-lab; install it with: pip install contactfusion-lab"
