"""One run, many runs and their results, of a mass and of a mechanical system."""
