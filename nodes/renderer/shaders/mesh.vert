#version 330 core
// One source for the figure (normals and colours) and the ground (a texture).
layout(location = 0) in vec3 position;
#ifdef NORMAL_LOC
layout(location = NORMAL_LOC) in vec3 normal;
out vec3 v_normal;
#endif
#ifdef COLOR_0_LOC
layout(location = COLOR_0_LOC) in vec4 color_0;
out vec3 v_color;
#endif
uniform mat4 M;
uniform mat4 V;
uniform mat4 P;
out vec3 v_position;

void main()
{
    vec4 world = M * vec4(position, 1.0);
    v_position = world.xyz;
#ifdef NORMAL_LOC
    v_normal = normal;  // figures are placed on the CPU: M is the identity
#endif
#ifdef COLOR_0_LOC
    v_color = color_0.rgb * color_0.rgb;  // sRGB to light, nearly
#endif
    gl_Position = P * V * world;
}
