"""The expert: contacts, centroidal plan, whole-body plan, torques."""
