"""A UR10e that presses a tool on a force sensor: contact by the currents of its motors alone."""
