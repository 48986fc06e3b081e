"""What a policy sees, what it learns from, and how it is trained; needs no robotics."""
