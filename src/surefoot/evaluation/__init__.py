"""What one controller can do, with intervals."""
