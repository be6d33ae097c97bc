"""Scene `press`: an arm in motion is pressed anywhere."""
