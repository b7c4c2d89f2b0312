"""Meshes to datasets: catalogues, partials, the factory (not built yet)."""
