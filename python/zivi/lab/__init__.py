"""The interactive page, ``zivi lab``: computations and figures, separate from the page.

`settings` hold the inputs of the page, `runs` simulates them, `script` writes the same run as
Python, `facts` and `figures` show the result. `page` is the marimo app, `server` serves it.
"""
