// Loads of rows of buffers: as texels in variants with TEXELS (see build/by_texels.rs), otherwise from the storage
// buffer.
#ifndef LOADS_GLSL
#define LOADS_GLSL

#ifdef TEXELS
#define LOAD4(plane, row) texelFetch(plane##_texels, int(row))
#define LOAD3(plane, row) texelFetch(plane##_texels, int(row)).xyz
#else
#define LOAD4(plane, row) plane[row]
#define LOAD3(plane, row) vec3(plane[3u * (row)], plane[3u * (row) + 1u], plane[3u * (row) + 2u])
#endif

#endif
