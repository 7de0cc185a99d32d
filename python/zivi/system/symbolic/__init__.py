"""Mechanical systems from their energies, derived by SymPy."""
