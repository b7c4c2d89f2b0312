"""Pictures and metrics of simulated and measured scans."""
