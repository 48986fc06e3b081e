"""When the expert takes over: gates, and the monitor that adds blocking."""
