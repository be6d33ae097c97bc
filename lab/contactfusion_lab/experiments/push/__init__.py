"""`experiment push`: the second paper's table, by controller and sensing (O §III, Table I)."""
