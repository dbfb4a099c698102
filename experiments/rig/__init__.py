"""The virtual test rig: its own physics, integrator and sensors; shares nothing with the model under test."""
