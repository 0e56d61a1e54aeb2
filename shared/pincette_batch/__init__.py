"""Many closed loops at once: gains × rigs × seeds, each with the numbers of the composed loop.

``kernel`` is what runs at the rate of the substeps and of the ticks, compiled; ``prepared`` makes
its constants of rig files and programs, ``zeroing`` lets the estimator itself answer a zero, and
``runs`` plays many cases, on one core or two. A loop that leaves the course the kernel follows is
played again by the composed loop.
"""
