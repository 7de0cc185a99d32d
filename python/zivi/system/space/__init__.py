"""Bodies that rotate in space, and shapes whose contacts are gaps."""
