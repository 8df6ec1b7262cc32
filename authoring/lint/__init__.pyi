from .linter import lint as lint
