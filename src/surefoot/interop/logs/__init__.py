"""What a robot has measured, replayed through its policy; what differs, and how."""
