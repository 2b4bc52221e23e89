"""Writes tests/studies/openep_v73.mat: a data set of OpenEP as MATLAB's `save -v7.3` lays it out.

A sheet of 3 x 3 vertices, 6 mm apart, with activation and voltage, and four points. With texts of the points, too:
tests/studies/openep_v73_texts.mat.
Run with h5py: python tests/python/openep_v73.py
"""

import h5py
import numpy as np

SIDE = 3
vertices = np.array([[6.0 * (v % SIDE), 6.0 * (v // SIDE), 0.0] for v in range(SIDE * SIDE)])
triangles = []
for v in range(SIDE * (SIDE - 1)):
    if v % SIDE < SIDE - 1:
        triangles += [[v + 1, v + 2, v + 1 + SIDE], [v + 2, v + 2 + SIDE, v + 1 + SIDE]]
values = np.stack([vertices[:, 0], 1.0 + 0.05 * vertices[:, 0]], 1)
values[1] = np.nan
data = {
    "surface/triRep/X": vertices,
    "surface/triRep/Triangulation": np.array(triangles, dtype=float),
    "surface/act_bip": values,
    "electric/egmX": vertices[:4] + [0.0, 0.0, 0.5],
    "electric/annotations/mapAnnot": np.array([[2000], [2010], [2020], [2900]], dtype=np.int32),
    "electric/annotations/referenceAnnot": np.full((4, 1), 2000, dtype=np.int32),
    "electric/annotations/woi": np.tile([-50.0, 200.0], (4, 1)),
    "electric/voltages/bipolar": np.array([[1.0], [1.5], [np.nan], [2.0]]),
}
texts = {
    "tags": ["", "scar", "", "  phrenic "],
    "electrodeNames_bip": ["A 1-2", "A 3-4", "µ 1-2", "A 1-2"],
}


def add_texts(file):
    """Cells of text: datasets of UTF-16 in a group of their own, and references to them."""
    cells = file.create_group("#refs#")
    for field, values in texts.items():
        references = []
        for value in values:
            units = np.frombuffer(value.encode("utf-16-le"), dtype=np.uint16)
            held = units[:, None] if value else np.zeros(2, dtype=np.uint64)
            cell = cells.create_dataset(f"c{len(cells)}", data=held)
            cell.attrs["MATLAB_class"] = np.bytes_("char")
            if not value:
                cell.attrs["MATLAB_empty"] = np.uint8(1)
            references.append(cell.ref)
        array = np.array([references], dtype=h5py.ref_dtype)
        dataset = file.create_dataset("userdata/electric/" + field, data=array, dtype=h5py.ref_dtype)
        dataset.attrs["MATLAB_class"] = np.bytes_("cell")


def write(path, has_texts):
    with h5py.File(path, "w", userblock_size=512, libver="earliest") as file:
        for name, array in data.items():
            dataset = file.create_dataset("userdata/" + name, data=array.T)
            kind = "int32" if array.dtype == np.int32 else "double"
            dataset.attrs["MATLAB_class"] = np.bytes_(kind)
        if has_texts:
            add_texts(file)
    with open(path, "r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(124, b" ") + b"\x00\x02IM")


write("tests/studies/openep_v73.mat", has_texts=False)
write("tests/studies/openep_v73_texts.mat", has_texts=True)
