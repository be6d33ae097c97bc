"""`experiment push`: the second paper's table, by controller and sensor suite (O §III, Table I)."""
