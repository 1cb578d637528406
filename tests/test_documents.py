"""What the documents say, as far as it can be checked without a running graph."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
SOURCES = ROOT / "ros2_ws/src"
DOCUMENTS = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/*.md"), *SOURCES.glob("*/*.md")])
LINK = re.compile(r"\[[^\]]*\]\((?!https?:)([^)#\s]*)(#[^)\s]*)?\)")
WORKFLOWS = sorted((ROOT / ".github/workflows").glob("*.yml"))
PACKAGES = sorted(path.parent.name for path in SOURCES.glob("*/setup.py"))


def headings(path):
    """Anchors of a document, as GitHub makes them."""
    lines = re.findall(r"^#+ (.+)$", path.read_text(), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", line.lower()).replace(" ", "-") for line in lines}


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_links_lead_somewhere(path):
    for target, anchor in LINK.findall(path.read_text()):
        file = path.parent / target if target else path
        assert file.exists(), f"{target} of {path.name}"
        if anchor:
            assert anchor[1:] in headings(file), f"{target}{anchor} of {path.name}"


@pytest.mark.parametrize("package", PACKAGES)
def test_packages_import_what_the_architecture_says(package):
    text = (ROOT / "docs/architecture.md").read_text()
    row = re.search(rf"^\| `{package}` \|.*\| ([^|]*)\|$", text, re.MULTILINE)
    assert row, f"{package} is not in the table"
    allowed = {f"husky_{name}" for name in re.split(r",\s*", row[1].strip()) if name}
    imported = set()
    for path in (SOURCES / package / package).rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                imported |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
                imported.add(node.module.split(".")[0])
    ours = {name for name in imported if name.startswith("husky_")} - {package, "husky_msgs"}
    assert ours == allowed


@pytest.mark.parametrize("package", ["husky_control", "husky_description", "husky_sim"])
def test_examples_run(package, capsys):
    blocks = re.findall(r"```python\n(.*?)```", (SOURCES / package / "README.md").read_text(), re.S)
    assert blocks
    for block in blocks:
        exec(compile(block, f"{package}/README.md", "exec"), {})


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.name)
def test_workflows_install_what_the_readme_names(path):
    """Besides, git and certificates for the checkout."""
    text = (ROOT / "README.md").read_text()
    readme = re.search(r"On Debian 12 these need `(.+)`,.*\nvideo `(.+?)`,", text)
    installed = re.search(r"apt-get install((?: \\\n|.)+)", path.read_text())
    assert readme and installed
    names = {word for word in installed[1].split() if word[0].isalpha()}
    assert names - {"ca-certificates", "git"} == set(f"{readme[1]} {readme[2]}".split())
