"""The instruments as their lines show them: tables of commands, free of I/O."""
