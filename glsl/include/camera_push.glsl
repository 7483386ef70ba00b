// The camera of a view as push constants, filled by src/pass/camera.rs.
#ifndef CAMERA_PUSH_GLSL
#define CAMERA_PUSH_GLSL
#include "camera.glsl"

layout(push_constant) uniform Push {
    vec4 row0;        // rotation row 0 | translation x (scene to camera)
    vec4 row1;
    vec4 row2;
    vec4 center;      // camera centre in the scene; w: near plane
    vec4 intrinsics;  // fx, fy, cx, cy in pixels
    vec4 limits;      // smallest x/z, largest x/z, smallest y/z, largest y/z that the EWA Jacobian sees
    uint width;       // image size in pixels
    uint height;
    uint sh_degree;   // 0 to 3
    uint flags;       // VIEW_*
} push;

Camera camera_from_push() {
    return Camera(push.row0.xyz, push.row1.xyz, push.row2.xyz, vec3(push.row0.w, push.row1.w, push.row2.w),
                  push.center.xyz, push.center.w, push.intrinsics.xy, push.intrinsics.zw, push.limits);
}

bool view_has(uint flag) { return (push.flags & flag) != 0u; }

#endif
