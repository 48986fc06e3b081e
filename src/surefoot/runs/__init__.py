"""A run's folder, and the stages that every method is made of."""
