"""An arm grasps an object by contact feedback."""
