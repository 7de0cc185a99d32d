"""Trees of rigid bodies that hinges and slides join."""
