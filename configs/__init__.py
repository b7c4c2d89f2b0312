"""Ready-made configuration files (TOML)."""
