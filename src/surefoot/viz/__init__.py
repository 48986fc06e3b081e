"""Films, plots and replays."""
