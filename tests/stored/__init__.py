"""What version 0.1 stored: pickles, a study half done and files of results; `make` wrote them."""
