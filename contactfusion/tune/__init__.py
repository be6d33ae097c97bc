"""Search of the settings that detect labelled contacts best."""
