"""Helpers without mechanics: checks, arrays, status, progress, formulas, compiled functions."""
