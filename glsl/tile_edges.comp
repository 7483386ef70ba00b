#version 460
// tile_edges: where the rows of tiles of each splat begin and end. `edges` has a word per tile and one more per row of
// tiles, and is zero beforehand. A splat adds 1 at its first tile of a row and subtracts 1 behind its last, so that the
// sum of the words up to a tile is the number of splats on the tile: two additions for a row of any length. One thread
// owns one splat; a workgroup owns 64 consecutive splats, and adds those on the image to the word behind the last row.
// Sums of words are exact in any order.
#extension GL_GOOGLE_include_directive : require
//! texels
#include "common.glsl"
#include "counters.glsl"
#include "loads.glsl"
#include "tile.glsl"
#include "tile_edges.glsl"
layout(local_size_x = 64) in;
layout(set = 0, binding = 0) readonly buffer Splat2d { vec4 splat2d[]; };
layout(set = 0, binding = 1) readonly buffer TileCounts { uint tile_counts[]; };
layout(set = 0, binding = 2) readonly buffer Counters { uint counters[]; };
layout(set = 0, binding = 3) buffer Edges { uint edges[]; };
layout(push_constant) uniform Push {
    uint width;
    uint height;
    uint tile_width;
    uint tile_height;
} push;

shared uint visible;

void main() {
    if (local_index() == 0u) visible = 0u;
    barrier();
    const TileGrid grid = TileGrid(uvec2(push.width, push.height), uvec2(push.tile_width, push.tile_height));
    const uvec2 tiles = tile_counts_of(grid);
    const uint splat = global_index();
    if (splat < counters[COUNTER_SPLATS] && tile_counts[splat] > 0u) {
        atomicAdd(visible, 1u);
        const TileEllipse e = ellipse_of(LOAD4(splat2d, 3u * splat), LOAD4(splat2d, 3u * splat + 1u), grid);
        for (uint y = e.row_begin; y < e.row_end; ++y) {
            const uvec2 columns = tile_row(e, y, grid);
            if (columns.x < columns.y) {
                atomicAdd(edges[edge_at(uvec2(columns.x, y), tiles)], 1u);
                atomicAdd(edges[edge_at(uvec2(columns.y, y), tiles)], ~0u);
            }
        }
    }
    barrier();
    if (local_index() == 0u && visible > 0u) atomicAdd(edges[edge_at(uvec2(0u, tiles.y), tiles)], visible);
}
