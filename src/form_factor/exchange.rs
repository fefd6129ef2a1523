//! The symmetric matrix of exchange areas A_i F_ij.

use super::Estimator;
use super::transport::{Row, Rows, Transport, gather_rows};
use crate::color::Rgb64;
use crate::patches::PatchId;
use serde::{Deserialize, Serialize};

/// Rows and columns of a tile: a quarter of a page, so that sparse parts of a scene cost little.
pub(super) const TILE: usize = 32;

pub(super) type Tile = [[f32; TILE]; TILE];

/// A_i F_ij in square units, stored once for both directions, in tiles on and above the diagonal.
/// Tiles in which nothing sees anything (coplanar walls, hidden rooms) are not stored.
#[derive(Serialize, Deserialize)]
pub struct ExchangeMatrix {
    areas: Vec<f64>,
    blocks: usize,
    /// Row by row: (0,0), (0,1), …, (1,1), (1,2), ….
    pub(super) tiles: Vec<Option<Box<Tile>>>,
}

impl ExchangeMatrix {
    /// Without a tile so far.
    pub(crate) fn none(of: &Estimator) -> Self {
        let patches = (0..of.mesh.len()).map(|i| PatchId(i as u32));
        ExchangeMatrix::of_areas(patches.map(|i| of.mesh.opaque_area(i)).collect())
    }

    fn of_areas(areas: Vec<f64>) -> Self {
        ExchangeMatrix { blocks: areas.len().div_ceil(TILE), areas, tiles: Vec::new() }
    }

    /// Memory that those tiles take that are there.
    pub(super) fn bytes(&self) -> u64 {
        (self.tiles.iter().flatten().count() * size_of::<Tile>()) as u64
    }

    /// One per pair of blocks.
    pub(super) fn all_tiles(&self) -> usize {
        self.blocks * (self.blocks + 1) / 2
    }

    /// The blocks of the tile of this number.
    pub(super) fn blocks_of(&self, tile: usize) -> (usize, usize) {
        // The last row whose first tile is not beyond it.
        let (mut row, mut end) = (0, self.blocks);
        while row + 1 < end {
            let middle = row.midpoint(end);
            if self.tile_number(middle, middle) <= tile {
                row = middle;
            } else {
                end = middle;
            }
        }
        (row, row + tile - self.tile_number(row, row))
    }

    /// Whether an estimator may have begun it.
    pub(super) fn is_possible(&self, of: &Estimator) -> bool {
        let empty = ExchangeMatrix::none(of);
        (&self.areas, self.blocks) == (&empty.areas, empty.blocks)
            && self.tiles.len() <= self.all_tiles()
            && (0..self.tiles.len()).all(|number| self.is_possible_tile(number))
    }

    /// Whether it holds exchanges, and none with patches that there are not.
    fn is_possible_tile(&self, number: usize) -> bool {
        let Some(tile) = &self.tiles[number] else { return true };
        let (row, column) = self.blocks_of(number);
        let [rows, columns] = [row, column].map(|block| self.areas.len() - block * TILE);
        let is_exchange = |(place, exchange): (usize, &f32)| {
            let is_there = place / TILE < rows && place % TILE < columns;
            if is_there { (0.0..=f32::MAX).contains(exchange) } else { *exchange == 0.0 }
        };
        tile.as_flattened().iter().enumerate().all(is_exchange)
    }

    /// Bytes that the matrix of this many patches takes if every tile is stored.
    pub fn bytes_needed(patches: usize) -> u64 {
        let blocks = patches.div_ceil(TILE) as u64;
        let tile = (size_of::<Tile>() + size_of::<Option<Box<Tile>>>()) as u64;
        (blocks * (blocks + 1) / 2).saturating_mul(tile)
    }

    #[inline]
    fn for_each_exchange(&self, i: PatchId, mut entry: impl FnMut(usize, f32)) {
        let (block, within) = (i.index() / TILE, i.index() % TILE);
        for other in 0..self.blocks {
            let Some(tile) = &self.tiles[self.tile_number(block.min(other), block.max(other))]
            else {
                continue;
            };
            let base = other * TILE;
            if other > block {
                for (j, &exchange) in tile[within].iter().enumerate() {
                    if exchange > 0.0 {
                        entry(base + j, exchange);
                    }
                }
            } else {
                for (j, row) in tile.iter().enumerate() {
                    // The diagonal tile holds only what is above the diagonal.
                    let mirrored = if other == block && j < within || other < block {
                        row[within]
                    } else {
                        tile[within][j]
                    };
                    if mirrored > 0.0 {
                        entry(base + j, mirrored);
                    }
                }
            }
        }
    }

    fn tile_number(&self, row: usize, column: usize) -> usize {
        // Rows before this one hold blocks, blocks − 1, … tiles.
        row * self.blocks - row * row.saturating_sub(1) / 2 + (column - row)
    }
}

impl Transport for ExchangeMatrix {
    fn len(&self) -> usize {
        self.areas.len()
    }

    fn gather(&self, radiosity: &[Rgb64]) -> Vec<Rgb64> {
        gather_rows(self, radiosity)
    }

    fn rows(&self) -> Option<&dyn Rows> {
        Some(self)
    }

    /// Zero: one stored number serves both directions.
    fn reciprocity_defect(&self) -> Option<f64> {
        Some(0.0)
    }
}

impl Rows for ExchangeMatrix {
    fn row(&self, i: PatchId) -> Row {
        let mut entries = Vec::new();
        self.for_each_in_row(i, &mut |j, factor| entries.push((PatchId(j as u32), factor)));
        Row { entries, on_backs: None }
    }

    fn for_each_in_row(&self, i: PatchId, entry: &mut dyn FnMut(usize, f64)) {
        let area = self.areas[i.index()];
        self.for_each_exchange(i, |j, exchange| entry(j, exchange as f64 / area));
    }

    fn gather_row(&self, i: PatchId, radiosity: &[Rgb64]) -> Rgb64 {
        let mut sum = Rgb64::ZERO;
        self.for_each_exchange(i, |j, exchange| sum += radiosity[j] * exchange as f64);
        sum / self.areas[i.index()]
    }

    /// `None`: a pair that does not see each other leaves no trace of what is in between.
    fn on_backs(&self, _: PatchId) -> Option<f64> {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Exchange (i, j) is i·1000 + j above the diagonal; patch i has area i + 1.
    fn numbered(n: usize) -> ExchangeMatrix {
        let blocks = n.div_ceil(TILE);
        let mut tiles = Vec::new();
        for row in 0..blocks {
            for column in row..blocks {
                let mut tile = Box::new([[0.0; TILE]; TILE]);
                for (a, line) in tile.iter_mut().enumerate() {
                    for (b, entry) in line.iter_mut().enumerate() {
                        let (i, j) = (row * TILE + a, column * TILE + b);
                        if i < j && j < n {
                            *entry = (i * 1000 + j) as f32;
                        }
                    }
                }
                tiles.push(Some(tile));
            }
        }
        let areas = (0..n).map(|i| (i + 1) as f64).collect();
        ExchangeMatrix { tiles, ..ExchangeMatrix::of_areas(areas) }
    }

    #[test]
    fn every_row_sees_both_halves_of_the_matrix() {
        let n = 2 * TILE + 5;
        let matrix = numbered(n);
        for i in 0..n {
            let mut row = vec![0.0; n];
            matrix.for_each_in_row(PatchId(i as u32), &mut |j, factor| row[j] += factor);
            for (j, &factor) in row.iter().enumerate() {
                let exchange = if i == j { 0 } else { i.min(j) * 1000 + i.max(j) };
                assert_eq!(factor, exchange as f64 / (i + 1) as f64, "F({i}, {j})");
            }
        }
    }

    #[test]
    fn a_tile_lies_where_its_number_says() {
        for blocks in [1, 2, 3, 17] {
            let matrix = ExchangeMatrix::of_areas(vec![1.0; blocks * TILE - 3]);
            let mut number = 0;
            for row in 0..blocks {
                for column in row..blocks {
                    assert_eq!(matrix.tile_number(row, column), number);
                    assert_eq!(matrix.blocks_of(number), (row, column));
                    number += 1;
                }
            }
            assert_eq!(matrix.all_tiles(), number);
        }
    }

    #[test]
    fn the_size_is_known_before_anything_is_allocated() {
        assert_eq!(ExchangeMatrix::bytes_needed(TILE), 4096 + 8);
        assert_eq!(ExchangeMatrix::bytes_needed(6144), 192 * 193 / 2 * (4096 + 8));
        assert!(ExchangeMatrix::bytes_needed(1 << 28) > 1 << 50);
    }
}
