// Places in `edges`, which tile_offsets turns into `tile_first`: a word for each tile and one more behind each row of tiles.
#ifndef TILE_EDGES_GLSL
#define TILE_EDGES_GLSL

// The word of a tile, or of the place behind the last tile of a row.
uint edge_at(uvec2 at, uvec2 tiles) { return at.y * (tiles.x + 1u) + at.x; }

#endif
