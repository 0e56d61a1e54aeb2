"""What is kept beyond a restart."""
