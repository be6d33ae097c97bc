"""The laboratory of contactfusion: scenes in PyBullet, experiments, training, and the demo."""
