classdef jaw < trocar.joints
    % The jaw of an instrument: one angle, rad.

    properties (Access = private)
        name
    end

    methods

        function self = jaw(bridge, name)
            % Made by trocar.psm.
            self@trocar.joints(bridge, [name '/jaw/']);
            self.name = name;
        end

        function servo_jp(self, jp)
            % Follow this angle now.
            self.joints_of.command(self.name, 'jaw/servo_jp', jp);
        end

        function servo_jf(self, jf)
            % Apply this effort (N·m) for 0.1 s, 0 until another command.
            self.joints_of.command(self.name, 'jaw/servo_jf', jf);
        end

        function handle = move_jp(self, jp)
            % Move to this angle: a trocar.move_handle.
            handle = self.joints_of.move(self.name, 'jaw/move_jp', jp);
        end

        function handle = open(self, angle)
            % Open, to 60 degrees unless told otherwise.
            if nargin < 2, angle = 60 * pi / 180; end
            handle = self.move_jp(angle);
        end

        function handle = close(self, angle)
            % Close, to -20 degrees unless told otherwise: the instrument grips.
            if nargin < 2, angle = -20 * pi / 180; end
            handle = self.move_jp(angle);
        end

    end

end
