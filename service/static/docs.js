"use strict";
// The description of this service, shown by Swagger UI. Nothing is asked of anybody else: no validator, no other address.
SwaggerUIBundle({
  url: "/openapi.json",
  dom_id: "#docs",
  validatorUrl: null,
  queryConfigEnabled: false,
  persistAuthorization: false,
  deepLinking: true,
  defaultModelsExpandDepth: 0,
  docExpansion: "list",
});
