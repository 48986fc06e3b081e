"""What one controller can do, with intervals; read `robustness` first."""
