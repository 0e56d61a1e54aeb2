"""Results from the samples of a job: values, figures, pictures, and their files."""
