"""Control laws, which compute the voltage from references, position and force."""
