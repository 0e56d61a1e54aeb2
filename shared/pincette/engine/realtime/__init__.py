"""What a program asks of the operating system so that it runs when it is due."""
