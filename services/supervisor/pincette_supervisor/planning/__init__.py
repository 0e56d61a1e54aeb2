"""Planning: from a request to a program for the controller."""
