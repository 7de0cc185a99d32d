"""What knows no mechanics: checks, arrays, status, progress, formulas, compiled functions."""
