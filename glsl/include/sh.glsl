// Real spherical harmonics up to degree 3 with the constants and signs of 3DGS (Kerbl et al. 2023; PlenOctrees), in
// four groups of four: group g holds coefficients 4g..4g+3. Coefficients above the degree get the value 0. A group of
// coefficients is three vec4: coefficient-major, colour fastest.
#ifndef SH_GLSL
#define SH_GLSL

const float SH_0 = 0.28209479177387814;
const float SH_1 = 0.4886025119029199;
const float SH_2A = 1.0925484305920792;
const float SH_2B = 0.31539156525252005;
const float SH_2C = 0.5462742152960396;
const float SH_3A = 0.5900435899266435;
const float SH_3B = 2.890611442640554;
const float SH_3C = 0.4570457994644658;
const float SH_3D = 0.3731763325901154;
const float SH_3E = 1.445305721320277;

vec4 sh_basis0(vec3 d, uint degree) {
    return degree < 1u ? vec4(SH_0, 0.0, 0.0, 0.0) : vec4(SH_0, -SH_1 * d.y, SH_1 * d.z, -SH_1 * d.x);
}

vec4 sh_basis1(vec3 d) {
    return vec4(SH_2A * d.x * d.y, -SH_2A * d.y * d.z, SH_2B * (2.0 * d.z * d.z - d.x * d.x - d.y * d.y),
                -SH_2A * d.x * d.z);
}

vec4 sh_basis2(vec3 d, uint degree) {
    const float xx = d.x * d.x, yy = d.y * d.y, zz = d.z * d.z;
    const float last2 = SH_2C * (xx - yy);
    return degree < 3u ? vec4(last2, 0.0, 0.0, 0.0)
                       : vec4(last2, -SH_3A * d.y * (3.0 * xx - yy), SH_3B * d.x * d.y * d.z,
                              -SH_3C * d.y * (4.0 * zz - xx - yy));
}

vec4 sh_basis3(vec3 d) {
    const float xx = d.x * d.x, yy = d.y * d.y, zz = d.z * d.z;
    return vec4(SH_3D * d.z * (2.0 * zz - 3.0 * xx - 3.0 * yy), -SH_3C * d.x * (4.0 * zz - xx - yy),
                SH_3E * d.z * (xx - yy), -SH_3A * d.x * (xx - 3.0 * yy));
}

// Sum over a group of basis value times RGB coefficient.
vec3 sh_sum(vec4 y, vec4 a, vec4 b, vec4 c) {
    return y.x * a.xyz + y.y * vec3(a.w, b.xy) + y.z * vec3(b.zw, c.x) + y.w * c.yzw;
}

// Per coefficient of a group: the RGB coefficient times the gradient of the colour.
vec4 sh_dot(vec3 g, vec4 a, vec4 b, vec4 c) {
    return vec4(dot(a.xyz, g), dot(vec3(a.w, b.xy), g), dot(vec3(b.zw, c.x), g), dot(c.yzw, g));
}

// Gradients with respect to the direction of dot(s, basis) for each group.
vec3 sh_slope0(vec4 s, uint degree) { return degree < 1u ? vec3(0.0) : SH_1 * vec3(-s.w, -s.y, s.z); }

vec3 sh_slope1(vec3 d, vec4 s) {
    return vec3(SH_2A * d.y * s.x - 2.0 * SH_2B * d.x * s.z - SH_2A * d.z * s.w,
                SH_2A * d.x * s.x - SH_2A * d.z * s.y - 2.0 * SH_2B * d.y * s.z,
                -SH_2A * d.y * s.y + 4.0 * SH_2B * d.z * s.z - SH_2A * d.x * s.w);
}

vec3 sh_slope2(vec3 d, vec4 s, uint degree) {
    vec3 g = 2.0 * SH_2C * s.x * vec3(d.x, -d.y, 0.0);
    if (degree >= 3u) {
        const float xx = d.x * d.x, yy = d.y * d.y, zz = d.z * d.z;
        g += -SH_3A * s.y * vec3(6.0 * d.x * d.y, 3.0 * (xx - yy), 0.0);
        g += SH_3B * s.z * vec3(d.y * d.z, d.x * d.z, d.x * d.y);
        g += -SH_3C * s.w * vec3(-2.0 * d.x * d.y, 4.0 * zz - xx - 3.0 * yy, 8.0 * d.y * d.z);
    }
    return g;
}

vec3 sh_slope3(vec3 d, vec4 s) {
    const float xx = d.x * d.x, yy = d.y * d.y, zz = d.z * d.z;
    vec3 g = SH_3D * s.x * vec3(-6.0 * d.x * d.z, -6.0 * d.y * d.z, 6.0 * zz - 3.0 * xx - 3.0 * yy);
    g += -SH_3C * s.y * vec3(4.0 * zz - 3.0 * xx - yy, -2.0 * d.x * d.y, 8.0 * d.x * d.z);
    g += SH_3E * s.z * vec3(2.0 * d.x * d.z, -2.0 * d.y * d.z, xx - yy);
    g += -SH_3A * s.w * vec3(3.0 * (xx - yy), -6.0 * d.x * d.y, 0.0);
    return g;
}

#endif
