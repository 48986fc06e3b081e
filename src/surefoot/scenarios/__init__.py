"""Where episodes begin, and what happens to the robot in them."""
