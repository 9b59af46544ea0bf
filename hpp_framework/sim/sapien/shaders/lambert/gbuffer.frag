#version 450
// Lambert shading without an environment map, so that a software renderer draws a frame in tens of milliseconds.
// Colour is the only output: writing positions and segmentation as well doubles the time of a frame.
// The uniform blocks mirror the interface of SAPIEN's own shader packs (Apache-2.0, the SAPIEN authors).
layout(set = 0, binding = 0) uniform CameraBuffer {
  mat4 viewMatrix;
  mat4 projectionMatrix;
  mat4 viewMatrixInverse;
  mat4 projectionMatrixInverse;
  float width;
  float height;
} cameraBuffer;
layout(set = 1, binding = 0) uniform ObjectTransformBuffer { mat4 modelMatrix; } objectTransformBuffer;
layout(set = 1, binding = 1) uniform ObjectDataBuffer {
  uvec4 segmentation;
  float transparency;
  int shadeFlat;
} objectDataBuffer;
layout(set = 2, binding = 0) uniform MaterialBuffer {
  vec4 emission;
  vec4 baseColor;
  float fresnel;
  float roughness;
  float metallic;
  float transmission;
  float ior;
  float transmissionRoughness;
  int textureMask;
  int padding1;
  vec4 textureTransforms[6];
} materialBuffer;
layout(set = 2, binding = 1) uniform sampler2D colorTexture;
layout(set = 2, binding = 2) uniform sampler2D roughnessTexture;
layout(set = 2, binding = 3) uniform sampler2D normalTexture;
layout(set = 2, binding = 4) uniform sampler2D metallicTexture;
layout(set = 2, binding = 5) uniform sampler2D emissionTexture;
struct PointLight { vec4 position; vec4 emission; };
struct DirectionalLight { vec4 direction; vec4 emission; };
struct SpotLight { vec4 position; vec4 direction; vec4 emission; };
layout(set = 3, binding = 0) uniform SceneBuffer {
  vec4 ambientLight;
  DirectionalLight directionalLights[3];
  SpotLight spotLights[10];
  PointLight pointLights[10];
  SpotLight texturedLights[1];
} sceneBuffer;

layout(location = 0) in vec4 inPosition;
layout(location = 3) in vec3 inNormal;
layout(location = 0) out vec4 outColor;

const float FLOOR_TOP = 0.005;   // metres; shadows lie just below
const float LINE = 0.012;        // half the width of a floor line, metres

// How much of a pixel a line along every whole metre covers.
float lines(vec2 at) {
  vec2 width = fwidth(at);
  vec2 away = abs(fract(at - 0.5) - 0.5);
  vec2 cover = clamp((LINE + width - away) / (2.0 * width), 0.0, 1.0) * min(vec2(1.0), LINE / width);
  return max(cover.x, cover.y);
}

void main() {
  vec3 color = materialBuffer.baseColor.rgb;
  vec3 normal = normalize(inNormal);
  vec3 world = (cameraBuffer.viewMatrixInverse * vec4(inPosition.xyz, 1.0)).xyz;
  if (normal.z > 0.99 && world.z < FLOOR_TOP) {
    float odd = mod(floor(world.x) + floor(world.y), 2.0);
    color *= (0.96 + 0.04 * odd) * (1.0 - 0.22 * lines(world.xy));
  }
  // sky light from above, a little from the floor
  vec3 light = sceneBuffer.ambientLight.rgb * (0.8 + 0.2 * normal.z);
  // one sun: what the buffer holds for lights that were never added is not defined
  DirectionalLight sun = sceneBuffer.directionalLights[0];
  light += sun.emission.rgb * max(0.0, dot(normal, -normalize(sun.direction.xyz)));
  outColor = vec4(pow(clamp(color * light, 0.0, 1.0), vec3(1.0 / 2.2)), 1.0);
}
