"""Derivatives of runs, and the map from one impact to the next."""
