"""Settings of the account: tests neither read nor write those of pincette."""

from collections.abc import Generator

import pytest

from pincette.core.user_folders import config_folder


@pytest.fixture(scope="session", autouse=True)
def account_settings(tmp_path_factory: pytest.TempPathFactory) -> Generator[None]:
    """Provide the account's settings folder without that of pincette."""
    shown = tmp_path_factory.mktemp("settings")
    folder = config_folder()
    for path in folder.iterdir() if folder is not None and folder.is_dir() else ():
        if path.name != "pincette":
            (shown / path.name).symlink_to(path)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CONFIG_HOME", str(shown))
        yield
