#version 330 core
// The figure: hemisphere ambient, wrapped key light, a soft highlight, rim, contact darkening.
// The ground: two grids of antialiased lines and the soft shadow, fading into the background.
// Alpha is what share of a pixel is figure.
in vec3 v_position;
#ifdef NORMAL_LOC
in vec3 v_normal;
#endif
#ifdef COLOR_0_LOC
in vec3 v_color;
#endif
uniform vec3 cam_pos;
uniform vec3 key;         // unit, towards the light
uniform vec3 background;  // sRGB
uniform vec4 window;      // centre x, z (m), 1 / width (1/m), darkness of the shadow's core
#ifdef HAS_BASE_COLOR_TEX
struct Material { sampler2D base_color_texture; };
uniform Material material;
#endif
out vec4 color;

#ifdef HAS_BASE_COLOR_TEX
float lines(vec2 place, vec2 width)
{
    vec2 near = abs(fract(place - 0.5) - 0.5) / width;
    return 1.0 - min(min(near.x, near.y), 1.0);
}

void main()
{
    vec2 place = v_position.xz;
    float far = length(place - window.xy);
    float fade = clamp(1.0 - (far - 1.8) * 0.13, 0.0, 1.0);
    fade *= fade * (3.0 - 2.0 * fade);
    vec2 width = fwidth(place) * 1.25;
    float fine = 1.0 - smoothstep(0.02, 0.11, max(width.x, width.y));  // no shimmer where cells are pixels
    float grid = lines(place, width) * 0.15 + lines(place * 4.0, width * 4.0) * 0.05 * fine;
    vec3 sun = mix(background, vec3(0.900, 0.905, 0.912), fade);
    float glow = exp(-0.22 * far * far);
    sun += vec3(0.022, 0.020, 0.016) * glow;
    vec2 at = (place - window.xy) * window.z + 0.5;
    float dark = texture(material.base_color_texture, at).r * window.w;
    vec3 tint = mix(vec3(1.0), vec3(0.80, 0.84, 0.93), dark);  // shadows keep the sky's blue
    color = vec4(sun * (1.0 - grid * fade) * (1.0 - dark) * tint, 0.0);
}
#else
void main()
{
    if (v_position.y < -0.001 && cam_pos.y > 0.0) discard;  // hidden by the ground
    vec3 n = normalize(v_normal);
    vec3 view = normalize(cam_pos - v_position);
    float up = n.y * 0.5 + 0.5;
    float lit = max(dot(n, key) * 0.78 + 0.22, 0.0);
    lit *= lit * 0.45 + 0.55;
    vec3 sky = mix(vec3(0.27, 0.245, 0.235), vec3(0.42, 0.46, 0.54), up);
    vec3 fill = vec3(0.10, 0.11, 0.13) * max(dot(n, normalize(vec3(-key.z, 0.25, key.x))), 0.0);
    float contact = clamp(v_position.y * 2.2 + 0.48, 0.0, 1.0);
    float high = max(dot(n, normalize(key + view)), 0.0);
    float gloss = pow(high, 48.0) * 0.17 + pow(high, 10.0) * 0.05;
    float edge = 1.0 - max(dot(n, view), 0.0);
    float rim = edge * edge * edge;
    vec3 light = v_color * (sky * contact + fill + vec3(1.12, 1.04, 0.93) * lit);
    light += gloss * lit + vec3(0.20, 0.23, 0.28) * rim * up;
    light = light * (1.0 + 0.06 * light) / (1.0 + 0.20 * light);
    color = vec4(sqrt(light), 1.0);
}
#endif
