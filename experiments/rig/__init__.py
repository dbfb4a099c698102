"""The virtual test rig: physics, sensors and campaign writer of its own."""
