classdef operated < handle
    % A console, a teleoperation or the system: what it shows, and what it is asked.

    properties (SetAccess = protected)
        name    % as in the system's file
        bridge  % the trocar.bridge by which it is reached
    end

    methods

        function self = operated(name, kind, varargin)
            % By a bridge as trocar.instance; trocar:argument when there is none of this name and kind.
            self.name = name;
            self.bridge = trocar.internal.connection(varargin{:});
            found = trocar.internal.kind_of(self.bridge, name);
            if ~strcmp(found, kind)
                error('trocar:argument', '%s is of the kind %s, not %s', name, found, kind);
            end
        end

        function result = connected(self)
            % Whether it shows fresh records.
            result = trocar.internal.is_shown(self.bridge, self.name);
        end

    end

    methods (Access = protected)

        function row = state(self)
            row = self.bridge.read([self.name '/state']);
        end

        function command(self, name, values, text)
            if nargin < 4, text = ''; end
            self.bridge.command(self.name, name, values, text);
        end

    end

end
