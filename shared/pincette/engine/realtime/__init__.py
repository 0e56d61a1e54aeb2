"""Settings of the operating system with which a program keeps its timing."""
