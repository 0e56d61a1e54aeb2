"""The free response, the position of the arm by the voltage alone, and its identification."""
