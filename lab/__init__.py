"""Makes lab/tests the package `lab.tests`, apart from the framework's `tests`."""
