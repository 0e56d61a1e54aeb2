"""A job's samples, its result, its pictures, its folder."""
