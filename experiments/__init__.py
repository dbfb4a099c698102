"""Runs and shows: commands, virtual rig, figures and reports."""
