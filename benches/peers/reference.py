"""A rigid ball presses an elastic block without friction: what the force is, by numpy and scipy alone.

`block` makes the tetrahedra, `same_mesh` solves the press of these very tetrahedra to rounding, and `quarter`
that of a quarter of the block by triquadratic hexahedra that are finer under the ball; two of these and their
trend are the `truth`. SI units, Y up."""

import numpy as np
import scipy.sparse as sp
from scipy.optimize import nnls
from scipy.sparse.linalg import splu

YOUNG, POISSON = 1e5, 0.3
LAME = YOUNG * POISSON / ((1 + POISSON) * (1 - 2 * POISSON))
SHEAR = YOUNG / (2 * (1 + POISSON))
SIZE = np.array([0.2, 0.1, 0.2])
RADIUS = 0.1
DEPTHS = [0.001, 0.002, 0.004]


def block(cells):
    """Nodes and tetrahedra of the block, its middle at the origin: `cells` cubes along x and z and half as
    many along y, of five tetrahedra each, mirrored from cube to cube so that faces agree."""
    n = np.array([cells, cells // 2, cells])
    axes = [np.linspace(-s / 2, s / 2, k + 1) for s, k in zip(SIZE, n)]
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    corner = np.arange(len(nodes)).reshape(n + 1)
    even = [[0, 3, 5, 6], [1, 0, 3, 5], [2, 0, 3, 6], [4, 0, 5, 6], [7, 3, 5, 6]]
    tets = []
    for i, j, k in np.ndindex(*n):
        cube = [corner[i + (c >> 2), j + (c >> 1 & 1), k + (c & 1)] for c in range(8)]
        if (i + j + k) % 2:
            cube = [cube[c ^ 1] for c in range(8)]
        tets += [[cube[c] for c in tet] for tet in even]
    tets = np.array(tets)
    x = nodes[tets]
    wrong = np.linalg.det(x[:, 1:] - x[:, :1]) < 0
    tets[wrong] = tets[wrong][:, [0, 1, 3, 2]]
    return nodes, tets


def write_medit(path, nodes, tets):
    """Writes the mesh as a Medit file."""
    rows = [" ".join(map(repr, row)) + " 0" for row in nodes.tolist()]
    cells = [" ".join(map(str, row)) + " 0" for row in (tets + 1).tolist()]
    head = ["MeshVersionFormatted 2", "Dimension 3", "Vertices", str(len(nodes))]
    path.write_text("\n".join(head + rows + ["Tetrahedra", str(len(tets))] + cells + ["End", ""]))


class Body:
    """An elastic body by finite elements: nodes, which of their components are free [n, 3], the nodes that
    may be touched and the triangles between them; and for every point of integration its weight and the
    gradients there: three sparse matrices [q, n], whose products with a field at the nodes are its slopes
    along x, y and z."""

    def __init__(self, nodes, free, touched, triangles, gradients, weights):
        self.nodes, self.free, self.touched = nodes, free.ravel(), touched
        self.gradients, self.weights = gradients, weights
        number = {node: i for i, node in enumerate(touched)}
        self.faces = {"nodes": None, "faces": [[number[node] for node in triangle] for triangle in triangles]}
        options = {"SymmetricMode": True}
        self.solve = splu(self.stiffness(), "MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options).solve
        self.compliance = self.of_touched()

    def stiffness(self):
        """Of linear elasticity, between free unknowns: ∫ λ ∂i v ∂j u + μ ∂j v ∂i u + δij μ ∇v · ∇u."""
        pair = [[a.T @ sp.diags(self.weights) @ b for b in self.gradients] for a in self.gradients]
        both = pair[0][0] + pair[1][1] + pair[2][2]
        block = lambda i, j: LAME * pair[i][j] + SHEAR * pair[j][i] + SHEAR * (i == j) * both
        whole = sp.bmat([[block(i, j) for j in range(3)] for i in range(3)], format="csr")
        order = np.arange(whole.shape[0]).reshape(3, -1).T.ravel()[self.free]
        return whole[order][:, order].tocsc()

    def of_touched(self):
        """Displacement of the touched nodes by forces there, [3m, 3m]."""
        number = np.full(len(self.free), -1)
        number[self.free] = np.arange(self.free.sum())
        unknowns = number[(3 * self.touched[:, None] + np.arange(3)).ravel()]
        own = np.flatnonzero(unknowns >= 0)
        result = np.zeros((len(unknowns), len(unknowns)))
        for column in own:
            load = np.zeros(self.free.sum())
            load[unknowns[column]] = 1.0
            result[own, column] = self.solve(load)[unknowns[own]]
        return result

    def moved(self, load):
        """Displacement of all nodes by forces on all, [n, 3]."""
        result = np.zeros(len(self.free))
        result[self.free] = self.solve(load.ravel()[self.free])
        return result.reshape(-1, 3)

    def linear(self, depth, where="nodes"):
        """Force on the ball by linear elasticity."""
        return press(self.compliance, self.nodes[self.touched], depth, self.faces[where])[0]

    def saint_venant(self, depth, where="nodes"):
        """With Saint Venant and Kirchhoff's law, which is MuJoCo's: what it adds to the linear forces acts as
        a load, until nothing changes."""
        load, before = np.zeros_like(self.nodes), np.inf
        for _ in range(300):
            x = self.nodes + self.moved(-load)
            force, on_nodes = press(self.compliance, x[self.touched], depth, self.faces[where])
            if abs(force - before) < 1e-7 * force:
                return force
            pushed = -load
            pushed[self.touched] += on_nodes
            before, load = force, self.added(self.moved(pushed))
        return np.nan

    def added(self, u):
        """What Saint Venant and Kirchhoff's law adds to the forces of linear elasticity, [n, 3]."""
        gradient = np.stack([slopes @ u for slopes in self.gradients], 2)
        turned = gradient.transpose(0, 2, 1)
        stress = lambda strain: LAME * np.einsum("qkk,ij->qij", strain, np.eye(3)) + 2 * SHEAR * strain
        linear = (gradient + turned) / 2
        more = (np.eye(3) + gradient) @ stress(linear + turned @ gradient / 2) - stress(linear)
        more *= self.weights[:, None, None]
        return sum(slopes.T @ more[:, :, k] for k, slopes in enumerate(self.gradients))


def same_mesh(nodes, tets):
    """The block of these very tetrahedra."""
    x = nodes[tets]
    edges = x[:, 1:] - x[:, :1]
    last = np.linalg.inv(edges).transpose(0, 2, 1)
    slopes = np.concatenate([-last.sum(1, keepdims=True), last], 1)
    rows = np.repeat(np.arange(len(tets)), 4)
    gradients = [
        sp.csr_matrix((slopes[:, :, k].ravel(), (rows, tets.ravel())), (len(tets), len(nodes)))
        for k in range(3)
    ]
    free = np.repeat(nodes[:, 1:2] > -SIZE[1] / 2 + 1e-9, 3, 1)
    near = top(nodes, 0.04)
    inside = np.isin(tets, near)
    triangles = tets[inside.sum(1) == 3][inside[inside.sum(1) == 3]].reshape(-1, 3)
    return Body(nodes, free, near, triangles, gradients, np.linalg.det(edges) / 6)


def top(nodes, radius):
    """Nodes of the top at most so far from its middle."""
    return np.flatnonzero((nodes[:, 1] > SIZE[1] / 2 - 1e-9) & (np.hypot(nodes[:, 0], nodes[:, 2]) < radius))


def quarter(cells):
    """A quarter of the block by triquadratic hexahedra, `cells` of them along the 22 mm from the middle that
    may be touched."""
    near = 0.022
    outer = np.linspace(0, 1, cells // 2 + 2)[1:]
    side = np.concatenate([np.linspace(0, near, cells + 1), near + (SIZE[0] / 2 - near) * outer**1.6])
    deep = SIZE[1] * np.linspace(0, 1, cells + 1) ** 2
    lines = [quadratic_line(points) for points in [side, SIZE[1] / 2 - deep[::-1], side]]
    nodes = np.stack(np.meshgrid(*[line[0] for line in lines], indexing="ij"), -1).reshape(-1, 3)
    kron = lambda of: sp.kron(sp.kron(of(0), of(1)), of(2)).tocsr()
    gradients = [kron(lambda axis: lines[axis][2 if axis == k else 1]) for k in range(3)]
    weights = np.einsum("i,j,k->ijk", *[line[3] for line in lines]).ravel()
    free = np.ones_like(nodes, bool)
    free[nodes[:, 0] < 1e-12, 0] = False
    free[nodes[:, 2] < 1e-12, 2] = False
    free[nodes[:, 1] < -SIZE[1] / 2 + 1e-12] = False
    return Body(nodes, free, top(nodes, near), [], gradients, weights)


def quadratic_line(points):
    """Quadratic elements on a line: their nodes, values and slopes at three points of Gauss in each, and
    weights of these."""
    nodes = np.sort(np.concatenate([points, (points[1:] + points[:-1]) / 2]))
    at, weight = np.polynomial.legendre.leggauss(3)
    value = np.stack([at * (at - 1) / 2, 1 - at**2, at * (at + 1) / 2], 1)
    slope = np.stack([at - 0.5, -2 * at, at + 0.5], 1)
    half = np.diff(points) / 2
    values, slopes = [sp.lil_matrix((3 * len(half), len(nodes))) for _ in range(2)]
    for e, length in enumerate(half):
        own = slice(3 * e, 3 * e + 3), slice(2 * e, 2 * e + 3)
        values[own], slopes[own] = value, slope / length
    return nodes, values.tocsr(), slopes.tocsr(), np.outer(half, weight).ravel()


def truth(grids, law):
    """Forces for elements of no size, from two grids, as errors that fall with the square of the size; how
    far the finer one is off."""
    coarse, fine = (4 * np.array([getattr(body, law)(depth) for depth in DEPTHS]) for body in grids.values())
    a, b = (cells**-2 for cells in grids)
    real = fine + (fine - coarse) * b / (a - b)
    return real, np.abs(fine / real - 1).max()


def press(c, x, depth, faces=None):
    """Force on a ball that has gone down by `depth` onto nodes `x` with the compliance `c`, without friction,
    and that on each node. What touches is each node, or with `faces`
    that point of each triangle which is nearest to the ball's middle. Points and the ball's normals there are
    those where the nodes come to be, found by repetition."""
    middle = np.array([0.0, SIZE[1] / 2 + RADIUS - depth, 0.0])
    u, points = np.zeros_like(x), np.eye(len(x))
    for turn in range(500):
        if faces is not None:
            points = nearest(middle, x + u, faces)
        away = points @ (x + u) - middle
        normal = away / np.linalg.norm(away, axis=1)[:, None]
        gap = np.einsum("ni,ni->n", normal, points @ x - middle) - RADIUS
        near = gap < depth / 10
        spread = (points[near, :, None] * normal[near, None, :]).reshape(near.sum(), -1).T
        w = spread.T @ c @ spread
        # More points than unknowns depend on one another.
        root = np.linalg.cholesky(w + 1e-9 * np.trace(w) / len(w) * np.eye(len(w)))
        force = nnls(root.T, -np.linalg.solve(root, gap[near]), maxiter=100000)[0]
        moved = (c @ (spread @ force)).reshape(-1, 3)
        change = np.abs(moved - u).max()
        u = u + (moved - u) * (1.0 if faces is None else 0.5 if turn < 50 else 0.05)
        if change < 1e-10 * depth / RADIUS:
            break
    else:
        print(f"  no equilibrium at {depth} m: nodes still move by {change:.1e} m")
    forces = (spread @ force).reshape(-1, 3)
    return -forces[:, 1].sum(), forces


def nearest(middle, x, faces):
    """Points of triangles nearest to `middle`, as weighted means of the nodes `x`, each once (C. Ericson,
    Real-Time Collision Detection, 2005, section 5.1.5)."""
    rows = set()
    for face in faces:
        a, b, c = x[face]
        edges = np.stack([b - a, c - a])
        inside = np.linalg.solve(edges @ edges.T, edges @ (middle - a))
        weights = np.array([1 - inside.sum(), *inside])
        if weights.min() < 0:
            tries = []
            for i, j in [(0, 1), (1, 2), (2, 0)]:
                along = x[face[j]] - x[face[i]]
                t = np.clip((middle - x[face[i]]) @ along / (along @ along), 0, 1)
                one = np.zeros(3)
                one[[i, j]] = 1 - t, t
                tries.append((np.linalg.norm(one @ x[face] - middle), tuple(one)))
            weights = np.array(min(tries)[1])
        rows.add(tuple(sorted((int(n), float(w)) for n, w in zip(face, weights) if w > 0)))
    result = np.zeros((len(rows), len(x)))
    for row, weights in zip(result, sorted(rows)):
        for node, weight in weights:
            row[node] = weight
    return result
