"""Equality rows: closed chains and prescribed motion."""
