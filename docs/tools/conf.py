"""Settings of Sphinx, see build.py."""

project = "flexlink-twin"
author = "The twin developers"
copyright = author

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
myst_enable_extensions = ["attrs_inline"]
myst_heading_anchors = 3

autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_typehints_format = "short"
napoleon_use_ivar = True
napoleon_custom_sections = [("Class attributes", "Attributes")]
python_use_unqualified_type_names = True

html_theme = "pydata_sphinx_theme"
html_static_path = ["static"]
html_css_files = ["wrap.css"]
html_title = "flexlink-twin"
html_copy_source = False
html_theme_options = {
    "github_url": "https://github.com/flexlink-twin/flexlink-twin",
    "header_links_before_dropdown": 9,
    "navigation_with_keys": False,
    "show_toc_level": 2,
    "footer_end": [],
}
