"""From the signal H to the completed shape (not built yet)."""
