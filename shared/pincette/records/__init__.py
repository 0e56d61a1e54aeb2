"""Records: the samples of a job as columns, and the files of its folder."""
