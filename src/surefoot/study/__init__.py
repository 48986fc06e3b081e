"""Studies of many runs, or of many variants of the expert; read `records` first."""
