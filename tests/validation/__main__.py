"""Print the tables, or write them into the page."""

import sys

from .table import HEADS, render, rows, write

if __name__ == "__main__":
    if "--write" in sys.argv:
        write()
    else:
        for table in HEADS:
            print(render(table))
            for row in rows(table):
                print(f"{row.difference:.1e}", row.quantity)
