"""The Zeno benchmark: motions with infinitely many impacts in finite time, and what is true.

``python -m zeno`` beside this folder. Nothing here but ``adapters/zivi_switched.py`` needs zivi;
the problems alone (``problems/*.json``) need nothing.
"""
