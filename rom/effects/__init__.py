"""Catalogue of effects that a model may lack, a file per family."""
