"""``pincette-madsci``: serve a rig as a node of MADSci; its settings are variables NODE_…."""
# pyright: basic, reportMissingImports=false

from pincette_madsci.node import Gripper


def main() -> None:
    """Serve until the program is stopped."""
    Gripper().start_node()


if __name__ == "__main__":
    main()
