"""Search for rewards and networks of skills, with Optuna."""

from importlib import import_module

from hpp_framework.utils.errors import ConfigError

try:
    import_module("optuna")
except ImportError as error:
    raise ConfigError("`hpp search` needs Optuna: pip install hpp-framework[search]") from error
