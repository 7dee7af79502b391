"""Optional packages: imported when a picture is asked for, with one clear error where they are absent."""

import importlib
from types import ModuleType


def require(module: str) -> ModuleType:
    """Import an optional package of the extra ``viz``.

    **Arguments**: `module`, its import name.

    **Returns**: the module.

    **Errors**: `ImportError` naming the package and the command that installs it.
    """
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        package = module.partition(".")[0]
        raise ImportError(
            f'{package} is needed for pictures and is not installed: pip install "icjax[viz]"', name=package
        ) from error
