#version 450
// See gbuffer.frag; the uniform blocks mirror the interface of SAPIEN's own shader packs (Apache-2.0).
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

layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec2 uv;
layout(location = 3) in vec3 tangent;
layout(location = 4) in vec3 bitangent;
layout(location = 0) out vec4 outPosition;
layout(location = 3) out vec3 outNormal;

void main() {
  mat4 model = objectTransformBuffer.modelMatrix;
  outNormal = mat3(transpose(inverse(model))) * normal;
  outPosition = cameraBuffer.viewMatrix * (model * vec4(position, 1.0));
  gl_Position = cameraBuffer.projectionMatrix * outPosition;
}
