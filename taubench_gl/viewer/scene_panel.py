"""The section of the scene: its nodes as a tree, in which one can be selected."""

from __future__ import annotations

from imgui_bundle import ImVec2, ImVec4, imgui

from taubench_gl.viewer.display import OUTLINE_COLOR
from taubench_gl.viewer.scene_tree import SceneTree
from taubench_gl.viewer.widgets import Widgets

INDENT = 12.0
"""Of a level of the tree, screen points."""
_NODE = imgui.TreeNodeFlags_.no_tree_push_on_open.value | imgui.TreeNodeFlags_.open_on_arrow.value


class ScenePanel:
    """Draws the section.  Only the rows in view are built: a scene can have thousands of nodes."""

    def __init__(self, ui: Widgets):
        self._ui = ui
        self._tree: SceneTree | None = None
        self._open: set[int] = set()  # nodes whose children are listed
        self._search = ""
        self._rows: list[tuple[int, int]] | None = None  # node and depth of each row; None: to be made again
        self._followed: int | None = None  # the selection that the rows were scrolled to

    def draw(self) -> None:
        viewer = self._ui.viewer
        s, tree = viewer.state, viewer.engine.feed.tree
        if tree is None:
            self._ui.faint("path-traced files have no nodes")
            return
        if tree is not self._tree:
            self._tree, self._open, self._search, self._rows, self._followed = tree, set(), "", None, None
        if s.selection != self._followed:
            self._followed = s.selection
            if s.selection is not None:
                self._open |= tree.ancestors(s.selection)
                self._search, self._rows = "", None
                self._ui.reveal = f"node.{tree.labels[s.selection]}"
        # Another name after a selection: a text field that is being edited keeps its own text.
        changed, self._search = imgui.input_text_with_hint(f"##search {self._followed}", "search", self._search)
        self._ui.place("search", slider=True)
        if changed or self._rows is None:
            self._rows = self._listed()
        clipper = imgui.ListClipper()
        clipper.begin(len(self._rows), imgui.get_text_line_height_with_spacing())
        if (self._ui.reveal or "").startswith("node."):  # a row that is to be scrolled to must be built
            shown = (i for i, (node, _) in enumerate(self._rows) if self._ui.reveal == f"node.{tree.labels[node]}")
            for row in shown:
                clipper.include_item_by_index(row)
        while clipper.step():
            for node, depth in self._rows[clipper.display_start : clipper.display_end]:
                self._row(node, depth)

    def _listed(self) -> list[tuple[int, int]]:
        """Nodes whose name contains the search text, or without one the open part of the tree."""
        tree, text, rows = self._tree, self._search.lower(), []
        stack = [(node, 0) for node in reversed(tree.roots)]
        while stack:
            node, depth = stack.pop()
            if text in tree.labels[node].lower():
                rows.append((node, 0 if text else depth))
            if text or node in self._open:
                stack += [(child, depth + 1) for child in reversed(tree.children[node])]
        return rows

    def _row(self, node: int, depth: int) -> None:
        s, tree = self._ui.viewer.state, self._tree
        label = tree.labels[node]
        leaf = bool(self._search) or not tree.children[node]
        flags = _NODE | imgui.TreeNodeFlags_.leaf.value * leaf
        imgui.dummy(ImVec2(INDENT * depth, 0.0))
        imgui.same_line(0.0, 0.0)
        imgui.set_next_item_open(node in self._open)
        color = ImVec4(*OUTLINE_COLOR) if s.selection == node else imgui.get_style_color_vec4(imgui.Col_.text.value)
        imgui.push_style_color(imgui.Col_.text.value, color)
        imgui.tree_node_ex(str(node), flags, label)
        imgui.pop_style_color()
        self._ui.place(f"node.{label}")
        if imgui.is_item_toggled_open():
            self._open ^= {node}
            self._rows = None
        elif imgui.is_item_clicked():
            s.selection = self._followed = None if s.selection == node else node
        hidden = not self._ui.viewer.engine.visible(node)
        words = [tree.kinds[node], *["animated"] * bool(tree.animated[node]), *["hidden"] * hidden]
        imgui.same_line()
        self._ui.faint(", ".join(filter(None, words)))
