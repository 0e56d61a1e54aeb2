"""What the samples of a job say: its result, figures, pictures, and the files that keep them."""
