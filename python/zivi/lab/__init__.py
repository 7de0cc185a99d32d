"""The interactive page, ``zivi lab``: what is computed and drawn, apart from the page itself.

`settings` hold what the page asks for, `runs` simulates them, `script` writes the same as Python,
`facts` and `figures` show the result. `page` is the marimo app, `server` serves it.
"""
