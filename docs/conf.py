"""The documentation as a site: `make docs`. Built offline; a warning is an error.

The pages are Markdown that a forge shows as it is. Commands, keys of files, HTTP and effects are
written from the program whenever the site is built (`docs/made`, not kept), so that they cannot fall behind it.
"""

from __future__ import annotations

import sys
from importlib import metadata
from pathlib import Path

from sphinx.application import Sphinx

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))

from site_parts import mathml, reference  # noqa: E402

project = "TruePose"
copyright = "the authors of TruePose, MIT licence"
version = release = metadata.version("truepose")

extensions = ["myst_nb", "sphinx.ext.autodoc"]
exclude_patterns = ["build", "site_parts"]
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3
nb_execution_mode = "off"  # they hold what they printed: make notebooks

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_preserve_defaults = True

html_theme = "furo"
html_static_path = ["site_parts/static"]
html_css_files = ["notebooks.css"]
html_title = f"TruePose {release}"
html_copy_source = False
html_show_sourcelink = False
pygments_style = "friendly"


def setup(app: Sphinx) -> None:
    """Make the pages of the reference, and let browsers draw the equations: no script from elsewhere."""
    reference.write(HERE / "made")
    mathml.install(app)
