"""Periodic orbits of mechanical systems as words of events, their branches and their charts."""
