// Frames lie in a texture, 8 texels each: 3 rows of the pose before, 3 after, origin of its points with the
// height of its floor, metres of a step of its points.
const FRAMES_GLSL = `#version 300 es
precision highp float;
precision highp int;
precision highp sampler2D;
uniform sampler2D u_frames;
uniform mat4 u_clip_from_plan;
uniform float u_share;

vec4 texel(int frame, int k) {
  int at = 8 * frame + k;
  return texelFetch(u_frames, ivec2(at % 2048, at / 2048), 0);
}

vec3 rows(int frame, int first, vec4 p) {
  return vec3(dot(texel(frame, first), p), dot(texel(frame, first + 1), p), dot(texel(frame, first + 2), p));
}

vec3 place(int frame, vec3 point_cam) {
  vec4 p = vec4(point_cam, 1.0);
  if (u_share <= 0.0) return rows(frame, 0, p);
  if (u_share >= 1.0) return rows(frame, 3, p);
  return mix(rows(frame, 0, p), rows(frame, 3, p), u_share);
}
`;

const POINTS_GLSL =
  FRAMES_GLSL +
  `
layout(location = 0) in vec4 a_point;
layout(location = 1) in vec4 a_color;
layout(location = 2) in vec2 a_distance;
uniform int u_coloring;
uniform vec2 u_heights;
uniform float u_cut;
uniform float u_last_frame;
uniform float u_size_px;
uniform vec4 u_wall;    // ends of the chosen wall
uniform vec3 u_side;    // its normal, and whether there is one
uniform float u_frame;  // the chosen one; -1 without
out vec3 v_color;

vec3 ramp(float t, vec3 a, vec3 b, vec3 c) {
  t = clamp(t, 0.0, 1.0);
  return t < 0.5 ? mix(a, b, 2.0 * t) : mix(b, c, 2.0 * t - 1.0);
}

void main() {
  int frame = int(a_point.w + 0.5);
  vec3 p = place(frame, texel(frame, 6).xyz + a_point.xyz * texel(frame, 7).xyz);
  gl_Position = u_clip_from_plan * vec4(p, 1.0);
  if (p.z > u_cut) gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
  gl_PointSize = clamp(u_size_px / gl_Position.w, 1.5, 14.0);
  vec3 color = a_color.rgb;
  if (u_coloring == 1) {
    float t = (p.z - u_heights.x) / (u_heights.y - u_heights.x);
    color = ramp(t, vec3(0.15, 0.2, 0.5), vec3(0.2, 0.62, 0.52), vec3(0.98, 0.9, 0.3));
  } else if (u_coloring == 2) {
    float metres = (u_share < 0.5 ? a_distance.x : a_distance.y) * 0.51;
    color = ramp(metres / 0.3, vec3(0.0, 0.45, 0.7), vec3(0.94, 0.89, 0.5), vec3(0.84, 0.37, 0.0));
    // The plan says nothing of the floor, nor of what is no wall: what is half a metre off even after.
    if (a_distance.y > 0.99 || p.z - texel(frame, 6).w < 0.2) color = vec3(0.8);
  } else if (u_coloring == 3) {
    color = ramp(a_point.w / u_last_frame, vec3(0.27, 0.0, 0.45), vec3(0.13, 0.57, 0.55), vec3(0.99, 0.88, 0.2));
  }
  if (u_side.z > 0.5) {
    vec2 along = u_wall.zw - u_wall.xy, from = p.xy - u_wall.xy;
    float at = dot(from, along) / dot(along, along), off = dot(from, u_side.xy);
    bool is_near = at > -0.02 && at < 1.02 && abs(off) < 0.5;
    color = is_near
      ? ramp(0.5 + off / 0.4, vec3(0.0, 0.35, 0.75), vec3(0.75), vec3(0.8, 0.1, 0.1))
      : mix(color, vec3(0.93), 0.82);
  }
  if (u_frame >= 0.0 && abs(a_point.w - u_frame) < 0.5) color = mix(color, vec3(0.8, 0.0, 0.55), 0.55);
  v_color = color;
}`;

// Lines and dots fixed to cameras: the path is the origin of each.
const CAMERAS_GLSL =
  FRAMES_GLSL +
  `
layout(location = 0) in vec4 a_at;
uniform vec3 u_color;
uniform float u_dot_px;
out vec3 v_color;
void main() {
  gl_Position = u_clip_from_plan * vec4(place(int(a_at.w + 0.5), a_at.xyz), 1.0);
  gl_PointSize = u_dot_px;
  v_color = u_color;
}`;

const WALLS_GLSL = `#version 300 es
precision highp float;
layout(location = 0) in vec3 a_at;
layout(location = 1) in vec3 a_color;
uniform mat4 u_clip_from_plan;
out vec3 v_color;
void main() {
  gl_Position = u_clip_from_plan * vec4(a_at, 1.0);
  v_color = a_color;
}`;

const COLOR_GLSL = `#version 300 es
precision mediump float;
in vec3 v_color;
uniform float u_alpha;
out vec4 color;
void main() { color = vec4(v_color, u_alpha); }`;
