"""Who is who on the bus, and what each may do there."""
