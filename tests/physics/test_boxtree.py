"""The tree of boxes: every element once, every jello apart, and a walk through it that misses nothing."""

import numpy as np

from taichi_jello.physics.forces.soft_contact.search.box_tree import WIDE, BoxTree


def test_a_tree_holds_every_element_once_in_compact_nodes():
    sizes = [125, 0, 3, 700, 8]  # elements of each jello
    owner = np.repeat(np.arange(5), sizes)[::-1]
    grid = np.stack(np.meshgrid(*[np.arange(10.0)] * 3, indexing="ij"), -1).reshape(-1, 3)
    middle = np.random.default_rng(0).permutation(grid)[: len(owner)]
    single = np.arange(5) == 2
    tree = BoxTree.of(owner, middle, single)
    assert np.array_equal(np.sort(tree.order), np.arange(len(owner)))
    for j, size in enumerate(sizes):
        nodes = range(tree.start[j], tree.start[j + 1])
        assert (size > 0) == (len(nodes) > 0)
        leaves = [n for n in nodes if tree.skip[n] == n + 1]
        held = [e for n in leaves for e in tree.order[tree.first[n] : tree.last[n]]]
        assert np.array_equal(np.sort(held), np.flatnonzero(owner == j))
        assert all(tree.last[n] - tree.first[n] <= (1 if single[j] else WIDE) for n in leaves)
        for n in nodes:  # what is skipped with a node is what is in it
            inside = [m for m in leaves if n <= m < tree.skip[n]]
            assert tree.first[n] == tree.first[inside[0]] and tree.last[n] == tree.last[inside[-1]]
        blocks = [b for b in tree.block[nodes.start : nodes.stop] if b >= 0]
        assert [m for b in blocks for m in range(tree.leaf[b], tree.behind[b])] == leaves  # each leaf in one block
        for n in nodes:
            if tree.block[n] >= 0:
                b = tree.block[n]
                assert n <= tree.leaf[b] < tree.behind[b] == tree.skip[n] <= tree.leaf[b] + WIDE


def test_the_leaves_of_a_lattice_are_blocks():
    grid = np.stack(np.meshgrid(*[np.arange(8.0)] * 3, indexing="ij"), -1).reshape(-1, 3)
    tree = BoxTree.of(np.zeros(512, int), grid, np.zeros(1, bool))
    places = grid[tree.order].reshape(-1, 8, 3)
    assert np.all(places.max(1) - places.min(1) == 1.0)
    assert np.all(np.ptp(places.reshape(-1, 64, 3), axis=1) == 3.0)
