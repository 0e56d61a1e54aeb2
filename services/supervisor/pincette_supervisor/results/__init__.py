"""Results computed from the samples of a job: values, pictures, and their files."""
